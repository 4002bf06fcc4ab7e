"""Lock-step rollout: the agent's laws, filter and limits on the simulator's plant, without bus or clock.

Bit-repeatable from a seed, vectorised over robots and over trials; used for tuning and for every figure.
"""
