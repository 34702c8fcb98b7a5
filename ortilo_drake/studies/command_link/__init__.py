"""The flying loop behind a command link that loses or delays commands."""
