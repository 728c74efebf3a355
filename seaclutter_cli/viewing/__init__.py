"""Output for the Rerun viewer; the only part that imports rerun."""
