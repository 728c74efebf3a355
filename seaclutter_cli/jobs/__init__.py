"""Work on many recordings: engines that run tasks one after another, or in processes."""
