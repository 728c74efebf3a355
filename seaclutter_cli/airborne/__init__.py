"""What lies in the water, seen from the air: sea surface, texture, classes, objects (Shi et al. 2022)."""
