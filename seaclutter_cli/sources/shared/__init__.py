"""Parts that sources of several formats use."""
