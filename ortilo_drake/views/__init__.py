"""What is looked at: figures, pages, videos, block diagrams."""
