"""What runs a fleet as processes of this machine: children, restarts, their use of the machine."""
