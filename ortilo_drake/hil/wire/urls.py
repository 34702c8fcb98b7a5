"""The LCM buses that are used where none is named; with no import, so that the commands need no Drake to say them."""

DEFAULT_URL = "udpm://239.255.76.67:7667?ttl=0"  # ttl 0: this machine only; 1: the local network as well
ONBOARD_URL = "udpm://239.255.76.67:7668?ttl=0"  # the onboard half's, where a relay stands between
