"""Views of flights and results: figures, pages, videos, block diagrams."""
