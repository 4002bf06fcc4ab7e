"""The concurrent tasks of an agent: control, behaviour, orders, health. Each awaits its keys, calls, and sends."""
