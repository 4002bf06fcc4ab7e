"""What a robot can be told to do: one file each, named nowhere else."""
