"""Components shared by the sources of several formats."""
