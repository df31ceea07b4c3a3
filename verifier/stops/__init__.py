"""Real stops: found in recordings, measured, and what a model of them would have to be."""
