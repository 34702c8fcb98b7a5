"""Flights, one or many: their record, metrics and files, worker processes, and the two halves stepped tick by tick."""
