"""Hesai sensors: PandarXT-32 and Pandar40P."""
