"""The default LCM buses; without imports, so that the command line shows them without loading Drake."""

DEFAULT_URL = "udpm://239.255.76.67:7667?ttl=0"  # ttl 0: this machine only; 1: the local network as well
ONBOARD_URL = "udpm://239.255.76.67:7668?ttl=0"  # the onboard half's, where a relay stands between
