"""What a recording is like before anything is tracked: spectrum, front end, sampling clock, gaps, what repeats."""
