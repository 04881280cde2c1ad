"""Work on many machines, through Ray: cells of a matrix, and seeds of a run."""
