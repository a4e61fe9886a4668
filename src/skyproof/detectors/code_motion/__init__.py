"""Follow position and clock by codes alone, epoch by epoch: they must move as a platform and an oscillator can."""
