"""Simulated lidars: models, echoes, receiver, noise."""
