"""Studies, one folder a question: theory applied to the flying diagram, flights, figures and report."""
