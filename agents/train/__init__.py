"""Jobs: one training, several processes, a cluster, the bar on the terminal."""
