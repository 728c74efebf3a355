"""Parts of the method ``confirmed``: objects of a frame, their evidence, and tracks that collect it over time."""
