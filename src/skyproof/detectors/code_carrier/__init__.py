"""Compare code with carrier or Doppler of each signal alone: both must measure one range."""
