"""Lidar models (`catalog`) and the decoders of their packets (`families`)."""
