"""The study of sensitivity: how well a team must know its vehicle, room and sensors."""
