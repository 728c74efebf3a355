"""Ouster: OS0, OS1, OS2 with their metadata."""
