"""Hesai: PandarXT-32, Pandar40P."""
