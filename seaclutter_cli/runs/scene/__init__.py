"""The scene classifier: training, testing, and the scenes of recordings."""
