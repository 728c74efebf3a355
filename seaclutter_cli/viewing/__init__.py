"""A live look: frames as Rerun shows them. The only part that imports rerun."""
