"""A .usda as OpenUSD has it: schemas, validators, and which level is chosen from where.

usd.py USDA: needs usd-core 26.8 or newer.
"""

import sys

from pxr import Gf, Usd, UsdGeom, UsdLod, UsdValidation


def main(path):
    stage = Usd.Stage.Open(path)
    assert stage and not stage.GetCompositionErrors()
    assert UsdGeom.GetStageUpAxis(stage) == "Y" and UsdGeom.GetStageMetersPerUnit(stage) == 1
    root = stage.GetDefaultPrim()
    levels = root.GetChild("levels")
    assert levels.HasAPI(UsdLod.RootAPI)
    (target,) = levels.GetRelationship("lod:heuristics").GetTargets()
    heuristic = UsdLod.DistanceHeuristic(stage.GetPrimAtPath(target))
    assert heuristic, "the heuristic is one"
    kinds = [(child.GetName(), child.GetTypeName()) for child in levels.GetChildren()]
    assert kinds == [("splats", "ParticleField3DGaussianSplat"), ("blocks", "Mesh"), ("points", "Points")], kinds
    splats, blocks, points = (child for child in levels.GetChildren())
    for prim in stage.Traverse():
        for attribute in prim.GetAttributes():
            if attribute.HasAuthoredValue():
                assert attribute.GetTypeName() and attribute.IsDefined(), attribute.GetPath()
                assert prim.GetPrimDefinition().GetPropertyDefinition(attribute.GetName()) or attribute.GetName().startswith("primvars:"), (
                    f"{attribute.GetPath()} is in no schema"
                )
    count = len(splats.GetAttribute("positions").Get())
    for name in ("orientations", "scales", "opacities", "radiance:sphericalHarmonicsCoefficients"):
        assert len(splats.GetAttribute(name).Get()) == count, name
    assert all(abs(q.GetLength() - 1) < 1e-5 for q in splats.GetAttribute("orientations").Get())
    mesh = UsdGeom.Mesh(blocks)
    faces = mesh.GetFaceVertexIndicesAttr().Get(), mesh.GetFaceVertexCountsAttr().Get()
    valid, why = UsdGeom.Mesh.ValidateTopology(*faces, len(mesh.GetPointsAttr().Get()))
    assert valid, why
    boxes = {}
    for child in (splats, blocks, points):
        extent = child.GetAttribute("extent").Get()
        boxes[child.GetName()] = Gf.Range3d(Gf.Vec3d(extent[0]), Gf.Vec3d(extent[1]))
    middle = boxes["blocks"].GetMidpoint()
    size = boxes["blocks"].GetSize().GetLength()
    for name, box in boxes.items():
        assert (box.GetMidpoint() - middle).GetLength() < 0.1 * size, f"{name} lies elsewhere: {box}"
    thresholds = heuristic.GetThresholdsAttr().Get()
    assert len(thresholds) == 2 and thresholds[0] < thresholds[1]
    chosen = []
    query = heuristic.CreateDistanceHeuristicQuery()
    for distance in (0.5 * thresholds[0], 0.5 * (thresholds[0] + thresholds[1]), 2 * thresholds[1]):
        eye = Gf.Vec3d(heuristic.GetCenterAttr().Get()) + Gf.Vec3d(0, 0, distance)
        chosen.append(query.ComputeLOD(eye, Gf.Matrix4d(1)))
    assert chosen == [0, 1, 2], chosen
    failed = validate(stage)
    version = ".".join(map(str, Usd.GetVersion()[1:]))
    print(f"OpenUSD {version}: {count} splats up to {thresholds[0]:.0f} m, {len(mesh.GetFaceVertexCountsAttr().Get())} faces up to "
          f"{thresholds[1]:.0f} m, {len(points.GetAttribute('points').Get())} points beyond; {failed} complaints of its validators")


def validate(stage):
    """Complaints of all validators of OpenUSD, printed."""
    registry = UsdValidation.ValidationRegistry()
    context = UsdValidation.ValidationContext(registry.GetOrLoadAllValidators())
    complaints = context.Validate(stage)
    for complaint in complaints:
        print(f"{complaint.GetName()}: {complaint.GetMessage()}")
    return len(complaints)


if __name__ == "__main__":
    main(*sys.argv[1:])
