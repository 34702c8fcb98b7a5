"""The Cramer-Rao bound of a flight: what the measurements of its arrivals could tell at best."""
