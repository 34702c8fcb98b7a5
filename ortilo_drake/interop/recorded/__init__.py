"""Motions that others recorded: tables, bags and MCAP files, read as plain arrays with stamps."""
