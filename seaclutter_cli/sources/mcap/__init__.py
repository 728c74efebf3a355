"""MCAP files, intact or damaged: `source.McapSource`."""
