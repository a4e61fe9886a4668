"""Compare the code of each tracked signal with what its own Doppler adds up to."""
