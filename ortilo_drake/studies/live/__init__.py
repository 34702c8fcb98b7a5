"""The filter of `ortilo replay`, fed live with real sensors' messages."""
