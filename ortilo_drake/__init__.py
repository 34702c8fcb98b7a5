"""A laboratory for indoor navigation with sensors that come and go, built on Drake."""

__version__ = "0.1.0"
