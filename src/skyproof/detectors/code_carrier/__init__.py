"""Code against carrier or Doppler of each signal by itself: do both measure one range?"""
