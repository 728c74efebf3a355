"""Hesai's rotating sensors."""
