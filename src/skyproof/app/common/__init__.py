"""What several use cases share: settings, folder, progress, RINEX files, windows."""
