"""The robust form of the paper's filter: gates and weights in front of it, which pass only plausible measurements."""
