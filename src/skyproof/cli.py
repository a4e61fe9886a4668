"""Arguments in, words out: one function a command."""
