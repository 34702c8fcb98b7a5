"""The best that could have been known of a flight: every estimate by all measurements, those to come as well."""
