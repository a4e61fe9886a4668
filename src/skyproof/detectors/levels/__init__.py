"""C/N0 and front-end levels of one receiver against their own past: false signals' power, and interference."""
