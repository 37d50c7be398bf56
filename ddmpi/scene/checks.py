"""Mistakes of a whole scene: tables that are right by themselves and do not go together, each in a sentence."""

import unicodedata
from collections import Counter
from typing import Any

from ddmpi.errors import nearest
from ddmpi.scene.formulas import check_formulas, formulas_of
from ddmpi.scene.motions import wrong_motions
from ddmpi.scene.values import Mistakes, tables
from ddmpi.system.files import LONGEST, contact_files


def mistakes(scene: Any) -> Mistakes:
    """What is wrong with a `Scene`; the first sentence is certain, later ones may follow from it. Raises ValueError for
    formulas that cannot be evaluated."""
    yield from _unnamed(scene.contact)
    yield from _names(scene)
    yield from _files(scene.contact)
    for key, table in tables(scene):
        for name, value in formulas_of(table):
            check_formulas(f"{key}.{name}", value)
    for contact in scene.contact:
        yield from _partners(scene, contact)
        yield from _roles(scene, contact)
        yield from _sides(contact)
    yield from _materials(scene)
    yield from _copies(scene)
    yield from _images(scene)
    yield from _around_axis(scene)
    yield from _histories(scene)
    for contact in scene.contact:
        yield from _pretension(scene, contact)
        rubs = contact.rubbing[1]
        if rubs and min(scene.history[rubs].factors) < 0.0:
            yield (
                f"contact.{contact.called}.friction: [history.{rubs}] has a negative factor, and friction is not "
                "negative"
            )
        if contact.layer and scene.method.for_one:
            yield (
                f'contact.{contact.called}.softness: a soft joint needs outer = "newton", the default, not '
                f"method.{scene.method.for_one}"
            )
    if scene.time:
        yield from _load_steps(scene)
    yield from wrong_motions(scene)
    yield from _heat(scene.body)
    two = (len(scene.body), len(scene.rigid), len(scene.contact)) == (2, 0, 1)
    two = two and scene.contact[0].kind == "unilateral" and not scene.contact[0].itself
    if scene.method.for_two and not two:
        yield (
            f"method.{scene.method.for_two} is for two supported bodies with one unilateral contact; "
            "beyond that the published iteration diverges for theta >= 0.02, accelerated or not; use "
            'outer = "newton", the default'
        )


def _unnamed(contacts: list[Any]) -> Mistakes:
    """Contacts of the same bodies have names, and contacts have sides of their own."""
    pairs: set[frozenset[str]] = set()
    sides: dict[frozenset[tuple[str, str]], str] = {}
    for number, contact in enumerate(contacts):
        first, second = contact.bodies
        pair = frozenset(contact.bodies)
        if contact.name is None and pair in pairs:
            yield (
                f"contact.{number}: a second contact between {first!r} and {second!r} must be named; "
                f'add name = "…"'
            )
        pairs.add(pair)
        both = frozenset(zip(contact.bodies, (*contact.on, ""), strict=False))
        if both in sides:
            yield (
                f"contact.{contact.called}: is between the same sides as contact.{sides[both]}; forces and slip "
                "bounds of both would add up, so leave one of them out"
            )
        sides[both] = contact.called


def _names(scene: Any) -> Mistakes:
    """Bodies and rigid partners share one list of names, contacts have another."""
    named = {
        "body": [body.name for body in scene.body],
        "rigid": [rigid.name for rigid in scene.rigid],
        "contact": [contact.called for contact in scene.contact],
    }
    for key, names in named.items():
        for name, number in Counter(names).items():
            if number > 1:
                yield (
                    f'{key}.{name}: {number} [[{key}]] tables have this name; give each name = "…" of '
                    "its own"
                )
    for name in named["rigid"]:
        if name in named["body"]:
            yield (
                f"rigid.{name}: a [[body]] has this name, too; rename one of them, because "
                "contacts name both in the same way"
            )


def _files(contacts: list[Any]) -> Mistakes:
    """The files of contacts differ, also on file systems that do not distinguish capitals and small letters."""
    written: dict[str, tuple[str, str]] = {}
    named = [
        (contact.called, file) for contact in contacts for file in contact_files(contact.called)
    ]
    for name, file in named:
        size = len(file.encode())
        if size > LONGEST:
            yield (
                f"contact.{name}: is too long for the name of a file; {file} has {size} bytes, and "
                f'{LONGEST} are allowed; give the contact a shorter name = "…"'
            )
        plain = unicodedata.normalize("NFC", file).casefold()
        other, same = written.setdefault(plain, (name, file))
        if other != name:
            alike = f" and {same}, which are the same on some file systems" * (same != file)
            yield (
                f"contact.{name}: this contact and contact.{other} would both write {file}{alike}; "
                'rename one of them by name = "…"'
            )


def _partners(scene: Any, contact: Any) -> Mistakes:
    """A contact is between two bodies, or a body and then a rigid partner."""
    key = f"contact.{contact.called}.bodies"
    bodies = [body.name for body in scene.body]
    rigid = [partner.name for partner in scene.rigid]
    for name in contact.bodies:
        if name not in bodies and name not in rigid:
            lists = f"bodies: {', '.join(bodies)}" + f"; rigid: {', '.join(rigid)}" * bool(rigid)
            yield (
                f"{key}: there is no body {'or rigid partner ' * bool(rigid)}{name!r}"
                f"{nearest(name, [*bodies, *rigid])} ({lists})"
            )
    first, second = contact.bodies
    if first in rigid and second in rigid:
        yield f"{key}: {first!r} and {second!r} are both rigid; one of them must be a [[body]]"
    if first in rigid:
        yield (
            f"{key}: {first!r} is rigid and comes second; write bodies = "
            f'["{second}", "{first}"], on = ["{contact.on[-1]}"]'
        )


def _roles(scene: Any, contact: Any) -> Mistakes:
    """A contact has a group for each body, and a rigid partner none; what has no surface has bonds alone."""
    key = f"contact.{contact.called}"
    first, second = contact.bodies
    partner = next((rigid for rigid in scene.rigid if rigid.name == second), None)
    if partner and len(contact.on) > 1:
        faces = f", or on = [[{', '.join(contact.on)}]], both" * "".join(contact.on).isdigit()
        yield (
            f"{key}.on: {second!r} is rigid and has no boundary groups; write on = "
            f'["{contact.on[0]}"], the one of {first!r}{faces}'
        )
    if not partner and len(contact.on) < 2:
        yield (
            f"{key}.on: names a boundary group of {first!r}, and must name one of {second!r}, too; "
            f'write on = ["{contact.on[0]}", "…"]'
        )
    if partner and (contact.slave or contact.pairing):
        yield (
            f"{key}.{'slave' if contact.slave else 'pairing'}: {second!r} is rigid and has no nodes; "
            f"rows stand at the nodes of {first!r}, so leave this key out"
        )
    if partner and not partner.surface and contact.kind != "bonded":
        yield (
            f"{key}.kind: {second!r} is a node, which has no surface "
            'that could be touched; write kind = "bonded", or give it another shape'
        )


def _sides(contact: Any) -> Mistakes:
    """A contact of a body with itself has two sides, and the slave is one of both."""
    key = f"contact.{contact.called}"
    if contact.itself and len({*contact.on}) < 2:
        yield (
            f"{key}.on: both sides are {contact.on[0]!r} of {contact.bodies[0]!r}; a contact of a body with itself has two "
            "sides that face each other"
        )
    if contact.slave is not None and contact.slave not in contact.roles:
        what, many = ("side", "sides") if contact.itself else ("body", "bodies")
        yield (
            f"{key}.slave: {contact.slave!r} is not a {what} of this contact"
            f"{nearest(contact.slave, list(contact.roles))} ({many}: {', '.join(contact.roles)})"
        )


def _materials(scene: Any) -> Mistakes:
    """Parts with contacts or foundations have the depth of the others, and all meshes one order."""
    touched = {name for contact in scene.contact for name in contact.bodies}
    for body in scene.body:
        thick = any(one.thickness != 1.0 for one in body.materials)
        if thick and (body.foundation or body.name in touched):
            yield (
                f"body.{body.name}.material.thickness: bodies with contacts or foundations have the depth "
                "alone; leave it out"
            )
    orders = sorted({body.mesh.order for body in scene.body if body.mesh.order})
    if len(orders) > 1:
        yield (
            f"bodies have mesh.order {' and '.join(map(str, orders))}; forces at their common nodes "
            "would mean different pressures, so give all bodies the same"
        )


def _images(scene: Any) -> Mistakes:
    """Images are of bodies, and all turned ones make one wheel."""
    imaged = [contact for contact in scene.contact if contact.image]
    first = next((contact for contact in imaged if contact.image.turn), None)
    if scene.output.sectors and not first:
        yield "output.sectors: no contact has a turned image, so that there is one sector only; leave it out"
    if scene.output.sectors and scene.output.cut:
        yield "output.sectors: does not go with output.cut; leave one of them out"
    for contact in imaged:
        yield from (f"contact.{contact.called}.image: {words}" for words in _image(scene, contact))
        if first and contact.image.turn and not contact.image.of_one_wheel(first.image):
            yield (
                f"contact.{contact.called}.image: is turned about another axis or by another angle than that of "
                f"contact.{first.called}; a scene is a sector of one wheel"
            )


def _image(scene: Any, contact: Any) -> Mistakes:
    """What does not go with the image of a contact."""
    image = contact.image
    second = contact.bodies[1]
    if any(partner.name == second for partner in scene.rigid):
        yield f"{second!r} is rigid, and has none; move the partner to where it is touched"
    if scene.axisymmetric and (image.turn or image.shift[0]):
        yield "axisymmetric bodies have images along y only, as in shift = [0.0, 10.0]"
    if scene.time and scene.time.motions == "far":
        yield 'does not go with time.motions = "far"; leave one of them out'
    if contact.pretension:
        yield "a bond with a pretension has no image; leave one of them out"


def _copies(scene: Any) -> Mistakes:
    """Copies stay solids of revolution, and what a target makes finer, it makes finer alike."""
    for body in scene.body:
        copy = body.copy
        if copy and scene.axisymmetric and (copy.turn or (copy.shift and copy.shift[0])):
            yield (
                f"body.{body.name}.copy: axisymmetric copies shift along y only, as in shift = [0.0, 0.2]"
            )
        key = "target_error" if scene.method.target_error else "target"
        if copy and getattr(scene.method, key) and body.mesh.drawn:
            yield (
                f"body.{body.name}.copy: method.{key} makes the mesh of a drawing, a ball or a cylinder finer "
                "where its error is, which differs from copy to copy; write mesh and material, or leave the target out"
            )


def _around_axis(scene: Any) -> Mistakes:
    """Around an axis bonds are pulled and partners pushed along it, and nothing else has another half to show."""
    if not scene.axisymmetric:
        if scene.output.mirrored:
            yield (
                "output.mirrored: shows the other half of axisymmetric bodies; write axisymmetric = true "
                "at the top, or leave it out"
            )
        return
    for contact in scene.contact:
        if contact.pretension and contact.pretension.along[0]:
            yield (
                f"contact.{contact.called}.pretension.along: an axisymmetric bond is pulled along y "
                "only; write along = [0, 1] or [0, -1]"
            )
    for rigid in scene.rigid:
        pushed = "force" if rigid.force and rigid.force[0] else "free"
        if rigid.turning or 0 in rigid.pushed:
            yield (
                f"rigid.{rigid.name}.{'pivot' if rigid.turning else pushed}: an axisymmetric partner is "
                "pushed along y only and does not turn, because radial forces cancel around the axis"
            )


def _histories(scene: Any) -> Mistakes:
    """Histories exist, and there are load steps for them."""
    for key, table in tables(scene):
        name = getattr(table, "history", None)
        if name is not None and name not in scene.history:
            yield (
                f"{key}.history: there is no [history.{name}]{nearest(name, list(scene.history))} "
                f"(histories: {', '.join(scene.history) or 'none'})"
            )
    if scene.time:
        return
    for name in scene.history:
        yield (
            f"history.{name}: a history needs [time], as in [time], points = "
            "[1.0, 2.0]; without it all loads act at once"
        )
    if scene.output.animation:
        yield "output.animation: plays load steps, and without [time] there is only one; leave it out"


def _pretension(scene: Any, contact: Any) -> Mistakes:
    """The history of a pretension ends after the first load step, and not within a cycle."""
    name = contact.pretension and contact.pretension.history
    if not name:
        return
    end = scene.history[name].times[-1]
    ends = f"contact.{contact.called}.pretension.history: [history.{name}] ends"
    if end <= 0.0:
        yield (
            f"{ends} at time {end:g}, before the first load step, so that the force would never "
            "act; let it end at a later time, or leave it out"
        )
    cycle = scene.time.cycle
    # Each cycle would give the force anew, and let the offset go that the one before has kept.
    if cycle and cycle.repeat > 1 and cycle.begin < end <= cycle.to:
        yield (
            f"{ends} within the cycle from {cycle.begin:g} to {cycle.to:g}; let it end before or later"
        )


def _load_steps(scene: Any) -> Mistakes:
    """The method supports load steps, and cycles end with the loads with which they begin."""
    if scene.method.for_one:
        yield (
            f"time: method.{scene.method.for_one} solves a single load step; several need "
            'outer = "newton", the default'
        )
    yield from scene.time.wrong_cycle(scene.history)
    for key in ("target_error", "target"):
        if getattr(scene.method, key):
            yield (
                f"time: method.{key} is for one load step{', as converge is' * (key == 'target')}; refine the "
                "meshes by mesh.divisions or mesh.refine"
            )


def _heat(bodies: list[Any]) -> Mistakes:
    """Where materials expand, a body has a temperature; others keep that of the state free of stress."""
    expanding = [
        body.name
        for body in bodies
        if any(material.expansions.any() for material in body.materials)
    ]
    if expanding and all(body.temperature is None for body in bodies):
        yield (
            f"body.{expanding[0]}.material.expansion: no body has a temperature, so nothing expands; "
            "write temperature = 80.0 (K over the state free of stress) into a [[body]], or leave "
            "expansion out"
        )
