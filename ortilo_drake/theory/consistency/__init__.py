"""Statistics of a filter's errors and innovations."""
