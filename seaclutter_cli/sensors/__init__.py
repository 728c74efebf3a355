"""Lidar models (`catalog`) and decoders for their packets (`families`)."""
