"""Position and clock from codes alone, epoch by epoch: do they go on as a platform and an oscillator can?"""
