"""Taxels on anybody's MuJoCo model: a pad on a link of a robot, flat or curved, of one geom, of several or of a mesh.

Lives here: the surface that carries a pad (`pad_surface`), how far bodies are from it (`geom_gap`, over
`pad_kernels`), the balance of a load on springs (`layer_balance`), the press (`pad_press`), and what a user calls:
`attached_pad` and `pad_reader`, whose names `tactsim.press` exports. The room imports the core alone, and no room of
the harness imports it: `tactsim.press` loads it when one of its names is first used.
"""
