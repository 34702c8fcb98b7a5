"""A relay between the halves that loses, delays and repeats packets; the same in virtual time."""
