"""An onboard half that is killed, starts again and takes over."""
