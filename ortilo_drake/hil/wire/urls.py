"""The default addresses. The module imports nothing, so that the command line shows them without loading Drake."""

DEFAULT_URL = "tcp://127.0.0.1:7667"  # the loopback address: this machine only
ONBOARD_URL = "tcp://127.0.0.1:7668"  # the address for the onboard half where a relay stands between the halves
