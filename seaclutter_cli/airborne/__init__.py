"""Airborne tiles: sea surface, texture, classification and objects [Shi2022]."""
