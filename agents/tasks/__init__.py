"""What an agent does side by side: control, behaviour, orders, health. Each awaits its keys, calls, and sends."""
