"""Scene classifier: training, evaluation and prediction on recordings."""
