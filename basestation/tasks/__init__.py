"""The base station's tasks, one page each: await the newest input, take it in, send the result."""
