"""What is true without us: constants, time, frames, codes, messages, orbits, atmosphere, sky geometry."""
