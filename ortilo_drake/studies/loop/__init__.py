"""The closed loop at hover: stability, margins, Riccati equations."""
