"""What the rendered camera and its detector do, measured for the projected camera."""
