"""Sensor models: the force that the tooth takes. All are asked by one call, `response`; MODELS lists them.

How models "axisymmetric" and "solid" come from a design to an answer:

1. `parameters`: the sensor and its load as numbers. The modulus of the sensed object is left to step 4.
2. `axisymmetric.mesh`, or `solid.mesh` and `solid.parts`: the mesh of a refinement, which unknowns its elements share,
   their matrices, and what is asked of them.
3. `finite_elements.elimination`: sensor and object are each condensed onto the unknowns of their contact.
4. `finite_elements.poles`: both together give the mesh's curve, its answers over the modulus of the object.
   `axisymmetric.curves` and `solid.system` take steps 2 to 4; `finite_elements.work` keeps their curves on disk.
5. `finite_elements.ladder`: curves of a mesh and of coarser ones bound its errors.
6. The first mesh whose bound meets the tolerance gives the answer, for each modulus. `axisymmetric.model`, and
   `solid.model` with `solid.ladders`, say which meshes and bounds, and read answers off a curve.
7. `table`: the answer as a `Response`, as every model gives it.

`surface` reads the curves that come with palpate; `price_list` tells "auto" which model is the cheapest. A picture's
displacements and pressures for one modulus are a `section` of `axisymmetric.curves` or `solid.system`.
"""
