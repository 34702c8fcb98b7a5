"""The robust form of the paper's filter: what stands before it, so that it hears what it can believe."""
