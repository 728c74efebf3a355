"""Classification of airborne tiles: separation, training, prediction."""
