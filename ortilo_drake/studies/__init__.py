"""Questions asked of the laboratory, a folder each: theory on the flying diagram, flights, figures, report."""
