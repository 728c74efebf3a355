"""MCAP files, whole or damaged: `source.McapSource`."""
