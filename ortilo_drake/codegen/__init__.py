"""The onboard half of a scenario as object code with a C header, made of the elements that fly."""
