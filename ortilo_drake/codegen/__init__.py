"""The export of a scenario's onboard half as object code with a C header, made from the elements that fly."""
