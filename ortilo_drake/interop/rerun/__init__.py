"""Recordings of flights for the Rerun viewer: one .rrd file with 3D, pictures, boxes and signals."""
