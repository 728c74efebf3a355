"""Euclidean and density-based clusters of points, exact and in bounded memory."""
