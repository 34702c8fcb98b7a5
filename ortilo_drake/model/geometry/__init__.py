"""The room's shapes, as rays meet them."""
