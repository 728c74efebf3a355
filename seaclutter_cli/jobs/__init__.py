"""Work on many recordings: engines that run tasks one after another, in processes, or on a cluster."""
