"""One flight, many flights, and what is learnt from them."""
