"""Materials as laws: strain and history in, stress, moduli and history out, all points at once.

A new law (damage, say) is one module with one class: the members of `Law` in `law`, constants
checked as `constants` does, its name in `gpusim.fem`, and its line here. What a law answers at a
point is all that elements, Newton and loads ask for; none of them knows laws by name.

In the order in which data passes:

- `law`: What a model asks of a material, what an element asks of a law, and its answer.
- `constants`: Constants of a material: one clear error for what isn't one number in its range.
- `isotropic_constants`: Two of elasticity, density, thermal expansion.
- `symmetric_tensors`: Symmetric tensors by their components, of second and fourth order.
- `cauchy_green`: Strains that a body can have.
- `logarithmic_strain`: ln(C) / 2 with its two derivatives, for laws that are written in it.
- `linear_elasticity`: Stress linear in the strain; a user's own material as a law.
- `isotropic`: Linear isotropic elasticity.
- `orthotropic`: Linear orthotropic elasticity.
- `saint_venant_kirchhoff`: Large displacements, small strains.
- `neo_hookean`: Compressible neo-Hookean elasticity.
- `isochoric_neo_hookean`: Distortion and volume apart.
- `hencky`: The law of small strain in logarithmic strain.
- `hardening`: The yield stress as a function of the accumulated plastic strain.
- `j2`: J2 plasticity (von Mises) with isotropic hardening, in logarithmic strain.
"""
