"""Theory of filters and loops as functions of matrices, independent of any scenario."""
