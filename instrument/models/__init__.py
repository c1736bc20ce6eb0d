"""Sensor models: the force that the tooth takes. All are asked by one call, `response`; MODELS lists them.

How models "axisymmetric" and "solid" come from a design to an answer:

1. `parameters`: the sensor and its load as numbers. The modulus of the sensed object is left to step 4.
2. `axisymmetric.mesh`, `numbering` and `bodies`, or `solid.mesh`, `parts` and `body`: the mesh of a refinement, which
   unknowns its elements share, and their matrices. What is asked of them is in `axisymmetric.forces`, `solid.goals`.
3. `finite_elements.fronts`: sensor and object are each condensed onto the unknowns of their contact.
4. `finite_elements.poles`: both together give the mesh's curve, its answers over the modulus of the object.
   `axisymmetric.curves` and `solid.system` take steps 2 to 4; `finite_elements.kept` keeps their curves on disk.
5. `finite_elements.error_estimate`: curves of a mesh and of coarser ones bound its errors.
6. `finite_elements.ladder`: the first mesh whose bound meets the tolerance gives the answer, for each modulus.
   `axisymmetric.model` and `solid.model` say which meshes and bounds, and read answers off a curve.
7. `table`: the answer as a `Response`, as every model gives it.

`stored` ships curves, which model "surface" reads; `prices` tells "auto" which model is the cheapest. Displacements and
pressures for one modulus are found apart, by `axisymmetric.direct` and `solid.section`.
"""
