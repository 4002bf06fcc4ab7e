"""The base station's tasks, one file each: await the newest input, process it, send the result."""
