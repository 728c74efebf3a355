"""Labels: what people or programs say is in a recording."""
