"""Hesai sensors: PandarXT-32, Pandar40P, Pandar64 and PandarQT."""
