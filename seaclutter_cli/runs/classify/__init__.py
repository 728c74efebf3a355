"""Airborne tiles: sea and what stands out of it, training, and objects with their classes."""
