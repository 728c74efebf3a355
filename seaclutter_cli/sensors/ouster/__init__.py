"""Ouster sensors: OS0, OS1 and OS2 with their metadata."""
