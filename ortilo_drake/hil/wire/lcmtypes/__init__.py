"""LCM types: the .lcm sources, and below them the Python that `lcm-gen -p --ppath . *.lcm` makes of them."""
