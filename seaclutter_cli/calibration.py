"""Initial thresholds from recordings that hold clutter."""
