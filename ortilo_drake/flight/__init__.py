"""One flight, many flights: the typed record, metrics, files, workers, the halves met at the ticks."""
