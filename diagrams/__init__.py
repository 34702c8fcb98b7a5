"""One file per Drake Diagram; the ready-made scenarios in scenarios/."""
