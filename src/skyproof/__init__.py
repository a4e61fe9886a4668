"""skyproof tells true satellite-navigation signals from false ones, and gives the true position and time back."""
