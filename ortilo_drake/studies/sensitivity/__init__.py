"""What a team must know of its vehicle, room and sensors, and how well."""
