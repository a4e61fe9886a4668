"""Find more signals of a satellite than an echo explains."""
