#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Writes the scenes of this folder: cornell-box.gltf, cornell-box-moving.gltf, material-gallery.gltf.

    python3 make-scenes.py [OUTPUT_DIRECTORY]

Only the standard library; the same bytes every time. README.md tells what the scenes are for.
"""
import base64
import json
import math
import os
import struct
import sys
import zlib

# --- The measured Cornell box: Cornell University Program of Computer Graphics, "Cornell Box Data",
# http://www.graphics.cornell.edu/online/box/data.html. Lengths in millimetres; +x is to the LEFT of the picture.
# Measurements are facts. The hole for the leg of a table in the original floor is left out.
CAMERA = dict(position=(278, 273, -800), focal=0.035, film=0.025)  # looks along +z, y up
HEIGHT = 548.8
WALLS = {
    "floor": ("white", [(552.8, 0, 0), (0, 0, 0), (0, 0, 559.2), (549.6, 0, 559.2)]),
    "back wall": ("white", [(549.6, 0, 559.2), (0, 0, 559.2), (0, HEIGHT, 559.2), (556, HEIGHT, 559.2)]),
    "right wall": ("green", [(0, 0, 559.2), (0, 0, 0), (0, HEIGHT, 0), (0, HEIGHT, 559.2)]),
    "left wall": ("red", [(552.8, 0, 0), (549.6, 0, 559.2), (556, HEIGHT, 559.2), (556, HEIGHT, 0)]),
}
CEILING = (0, 556, 0, 559.2)   # x0, x1, z0, z1
LIGHT = (213, 343, 227, 332)   # the lamp fills a hole in the ceiling
BLOCKS = {
    "short block": (165, [(130, 65), (82, 225), (240, 272), (290, 114)]),
    "tall block": (330, [(423, 247), (265, 296), (314, 456), (472, 406)]),
}
LIGHT_REFLECTANCE = 0.78
EMISSION = [(400, 0.0), (500, 8.0), (600, 15.6), (700, 18.4)]  # relative, linear between
# Reflectance from 400 to 700 nm in steps of 4 nm.
REFLECTANCE = {
    "white": """.343 .445 .551 .624 .665 .687 .708 .723 .715 .710 .745 .758 .739 .767 .777 .765 .751 .745 .748 .729 .745
.757 .753 .750 .746 .747 .735 .732 .739 .734 .725 .721 .733 .725 .732 .743 .744 .748 .728 .716 .733 .726 .713 .740 .754
.764 .752 .736 .734 .741 .740 .732 .745 .755 .751 .744 .731 .733 .744 .731 .712 .708 .729 .730 .727 .707 .703 .729 .750
.760 .751 .739 .724 .730 .740 .737""",
    "green": """.092 .096 .098 .097 .098 .095 .095 .097 .095 .094 .097 .098 .096 .101 .103 .104 .107 .109 .112 .115 .125
.140 .160 .187 .229 .285 .343 .390 .435 .464 .472 .476 .481 .462 .447 .441 .426 .406 .373 .347 .337 .314 .285 .277 .266
.250 .230 .207 .186 .171 .160 .148 .141 .136 .130 .126 .123 .121 .122 .119 .114 .115 .117 .117 .118 .120 .122 .128 .132
.139 .144 .146 .150 .152 .157 .159""",
    "red": """.040 .046 .048 .053 .049 .050 .053 .055 .057 .056 .059 .057 .061 .061 .060 .062 .062 .062 .061 .062 .060
.059 .057 .058 .058 .058 .056 .055 .056 .059 .057 .055 .059 .059 .058 .059 .061 .061 .063 .063 .067 .068 .072 .080 .090
.099 .124 .154 .192 .255 .287 .349 .402 .443 .487 .513 .558 .584 .620 .606 .609 .651 .612 .610 .650 .638 .627 .620 .630
.628 .642 .639 .657 .639 .635 .642""",
}
WAVELENGTHS = list(range(400, 701, 4))


# --- Spectrum to linear Rec. 709 RGB
def observer(w):
    """CIE 1931 2-degree observer, multi-lobe fit of Wyman, Sloan, Shirley, JCGT 2(2), 2013."""
    def g(mu, a, b):
        return math.exp(-0.5 * ((w - mu) / (a if w < mu else b)) ** 2)
    return (1.056 * g(599.8, 37.9, 31.0) + 0.362 * g(442.0, 16.0, 26.7) - 0.065 * g(501.1, 20.4, 26.2),
            0.821 * g(568.8, 46.9, 40.5) + 0.286 * g(530.9, 16.3, 31.1),
            1.217 * g(437.0, 11.8, 36.0) + 0.681 * g(459.0, 26.0, 13.8))


def apply(matrix, v):
    return [sum(matrix[i][j] * v[j] for j in range(3)) for i in range(3)]


BRADFORD = [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
BRADFORD_INVERSE = [[0.9869929, -0.1470543, 0.1599627], [0.4323053, 0.5183603, 0.0492912],
                    [-0.0085287, 0.0400428, 0.9684867]]
RGB_FROM_XYZ = [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560],
                [0.0556434, -0.2040259, 1.0572252]]
D65 = [0.95047, 1.0, 1.08883]


def rgb_of(spectrum):
    """The spectrum under the equal-energy illuminant E, adapted (Bradford) from E to Rec. 709's white D65.

    So a perfect reflector (and a lamp of equal energy) is exactly (1, 1, 1), greys stay neutral, and products of
    light and reflectance keep their meaning. Trapezoidal rule over the measured range; outside of it nothing is known.
    """
    xyz, white = [0.0] * 3, [0.0] * 3
    for i, w in enumerate(WAVELENGTHS):
        weight = 0.5 if i in (0, len(WAVELENGTHS) - 1) else 1.0
        for k, c in enumerate(observer(w)):
            xyz[k] += weight * c * spectrum[i]
            white[k] += weight * c
    # E's own tristimulus values over this range are the white; the adapted white is D65 with Y = 1.
    relative = [xyz[k] / white[k] for k in range(3)]
    source, target = apply(BRADFORD, [1.0, 1.0, 1.0]), apply(BRADFORD, D65)
    cone = apply(BRADFORD, relative)
    adapted = apply(BRADFORD_INVERSE, [cone[k] * target[k] / source[k] for k in range(3)])
    return [max(0.0, c) for c in apply(RGB_FROM_XYZ, adapted)]


def emission_spectrum():
    out = []
    for w in WAVELENGTHS:
        for (a, va), (b, vb) in zip(EMISSION, EMISSION[1:]):
            if a <= w <= b:
                out.append(va + (vb - va) * (w - a) / (b - a))
                break
    return out


def luminance(c):
    return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]


def cornell_colors():
    colors = {name: rgb_of([float(v) for v in text.split()]) for name, text in REFLECTANCE.items()}
    lamp = rgb_of(emission_spectrum())
    # The measured emission is relative. Its luminance is set to that of the radiance (17, 12, 4) which the field has
    # long used for this box, so that pictures are exposed alike; the hue is the measured one.
    scale = luminance((17, 12, 4)) / luminance(lamp)
    return colors, [c * scale for c in lamp]


# --- Small vector helpers
def sub(a, b):
    return tuple(x - y for x, y in zip(a, b))


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(a):
    length = math.sqrt(dot(a, a))
    return tuple(x / length for x in a)


def facing(quad, point, towards=True):
    """The quad wound so that its normal looks towards `point` (or away from it)."""
    normal = cross(sub(quad[1], quad[0]), sub(quad[2], quad[0]))
    centre = tuple(sum(p[i] for p in quad) / len(quad) for i in range(3))
    return quad if (dot(normal, sub(point, centre)) > 0) == towards else quad[::-1]


def look_at(eye, target):
    """Quaternion of a glTF camera (looks along -z, y up)."""
    z = unit(sub(eye, target))
    x = unit(cross((0, 1, 0), z))
    y = cross(z, x)
    m = [[x[i], y[i], z[i]] for i in range(3)]
    trace = m[0][0] + m[1][1] + m[2][2]
    if trace > 0:
        s = 2 * math.sqrt(trace + 1)
        q = ((m[2][1] - m[1][2]) / s, (m[0][2] - m[2][0]) / s, (m[1][0] - m[0][1]) / s, s / 4)
    else:
        i = max(range(3), key=lambda k: m[k][k])
        j, k = (i + 1) % 3, (i + 2) % 3
        s = 2 * math.sqrt(1 + m[i][i] - m[j][j] - m[k][k])
        q = [0, 0, 0, (m[k][j] - m[j][k]) / s]
        q[i], q[j], q[k] = s / 4, (m[j][i] + m[i][j]) / s, (m[k][i] + m[i][k]) / s
    return unit(q)


def rounded(v, digits=7):
    return [round(x, digits) + 0.0 for x in v]


# --- glTF
class Gltf:
    def __init__(self, resolution, extras=None):
        self.binary = bytearray()
        self.doc = {
            "asset": {"version": "2.0", "generator": "Quell make-scenes.py"},
            "scene": 0, "scenes": [{"nodes": [], "extras": dict({"resolution": resolution}, **(extras or {}))}],
            "nodes": [], "cameras": [], "materials": [], "meshes": [], "accessors": [], "bufferViews": [], "buffers": []}
        self.used = set()

    def add(self, kind, value):
        self.doc.setdefault(kind, []).append(value)
        return len(self.doc[kind]) - 1

    def view(self, data, target=None):
        while len(self.binary) % 4:
            self.binary.append(0)
        value = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)}
        if target:
            value["target"] = target
        self.binary += data
        return self.add("bufferViews", value)

    def floats(self, rows, target=None, bounds=False):
        rows = [r if isinstance(r, (tuple, list)) else (r,) for r in rows]
        data = b"".join(struct.pack("<%df" % len(r), *r) for r in rows)
        accessor = {"bufferView": self.view(data, target), "componentType": 5126, "count": len(rows),
                    "type": {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}[len(rows[0])]}
        if bounds:
            stored = [struct.unpack("<%df" % len(r), struct.pack("<%df" % len(r), *r)) for r in rows]
            accessor["min"] = [min(c) for c in zip(*stored)]
            accessor["max"] = [max(c) for c in zip(*stored)]
        return self.add("accessors", accessor)

    def indices(self, values):
        return self.add("accessors", {"bufferView": self.view(struct.pack("<%dH" % len(values), *values), 34963),
                                      "componentType": 5123, "count": len(values), "type": "SCALAR"})

    def geometry(self, positions, normals, uvs, triangles):
        attributes = {"POSITION": self.floats(positions, 34962, True), "NORMAL": self.floats(normals, 34962)}
        if uvs:
            attributes["TEXCOORD_0"] = self.floats(uvs, 34962)
        return {"attributes": attributes, "indices": self.indices(triangles)}

    def quads(self, quads, uv=None):
        positions, normals, uvs, triangles = [], [], [], []
        for q in quads:
            base = len(positions)
            n = unit(cross(sub(q[1], q[0]), sub(q[2], q[0])))
            positions += q
            normals += [n] * 4
            if uv:
                uvs += [uv(p, n) for p in q]
            triangles += [base, base + 1, base + 2, base, base + 2, base + 3]
        return self.geometry(positions, normals, uvs, triangles)

    def mesh(self, name, geometry, material):
        return self.add("meshes", {"name": name, "primitives": [dict(geometry, material=material)]})

    def node(self, name, **members):
        index = self.add("nodes", dict({"name": name}, **members))
        self.doc["scenes"][0]["nodes"].append(index)
        return index

    def extension(self, owner, name, value):
        self.used.add(name)
        owner.setdefault("extensions", {})[name] = value

    def lambert(self, name, color):
        m = {"name": name, "doubleSided": True,
             "pbrMetallicRoughness": {"baseColorFactor": rounded(color, 6) + [1], "metallicFactor": 0,
                                      "roughnessFactor": 1}}
        self.extension(m, "KHR_materials_specular", {"specularFactor": 0})  # pure Lambert
        return m

    def emitter(self, name, color, radiance):
        m = self.lambert(name, color)
        strength = max(radiance)
        m["emissiveFactor"] = rounded([c / strength for c in radiance], 6)
        self.extension(m, "KHR_materials_emissive_strength", {"emissiveStrength": round(strength, 6)})
        return m

    def animate(self, name, tracks):
        """tracks: (node, path, times, values)"""
        times, samplers, channels = {}, [], []
        for node, path, t, values in tracks:
            key = tuple(t)
            if key not in times:
                times[key] = self.floats(t, None, True)
            samplers.append({"input": times[key], "output": self.floats(values), "interpolation": "LINEAR"})
            channels.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": path}})
        self.add("animations", {"name": name, "samplers": samplers, "channels": channels})

    def png(self, name, width, height, rows):
        """An RGB image as an embedded PNG; returns a texture."""
        def chunk(kind, data):
            body = kind + data
            return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))
        raw = b"".join(b"\0" + bytes(min(255, max(0, int(c * 255 + 0.5))) for p in row for c in p) for row in rows)
        data = (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)) +
                chunk(b"IDAT", zlib.compress(raw, 9)) + chunk(b"IEND", b""))
        image = self.add("images", {"name": name, "mimeType": "image/png",
                                    "uri": "data:image/png;base64," + base64.b64encode(data).decode()})
        if "samplers" not in self.doc:
            self.add("samplers", {"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497})
        return self.add("textures", {"source": image, "sampler": 0})

    def write(self, path):
        self.doc["buffers"] = [{"byteLength": len(self.binary), "uri": "data:application/octet-stream;base64," +
                                base64.b64encode(bytes(self.binary)).decode()}]
        if self.used:
            self.doc["extensionsUsed"] = sorted(self.used)
        doc = {k: v for k, v in self.doc.items() if v != []}
        with open(path, "w", newline="\n") as f:
            json.dump(doc, f, separators=(",", ":"))
            f.write("\n")
        print("%s: %d bytes" % (os.path.basename(path), os.path.getsize(path)))


def metres(points):
    return [tuple(c / 1000.0 for c in p) for p in points]


def cornell(path, moving):
    g = Gltf([512, 512])
    colors, lamp = cornell_colors()
    material = {name: g.add("materials", g.lambert(name, color)) for name, color in colors.items()}
    light_material = g.add("materials", g.emitter("light", [LIGHT_REFLECTANCE] * 3, lamp))
    middle = metres([(278, 274.4, 279.6)])[0]
    for name, (color, quad) in WALLS.items():
        g.node(name, mesh=g.mesh(name, g.quads([facing(metres(quad), middle)]), material[color]))

    def ceiling_quad(x0, x1, z0, z1):
        return facing(metres([(x0, HEIGHT, z0), (x1, HEIGHT, z0), (x1, HEIGHT, z1), (x0, HEIGHT, z1)]), middle)
    x0, x1, z0, z1 = CEILING
    a, b, c, d = LIGHT
    frame = [ceiling_quad(x0, x1, z0, c), ceiling_quad(x0, x1, d, z1), ceiling_quad(x0, a, c, d),
             ceiling_quad(b, x1, c, d)]
    g.node("ceiling", mesh=g.mesh("ceiling", g.quads(frame), material["white"]))
    g.node("light", mesh=g.mesh("light", g.quads([ceiling_quad(*LIGHT)]), light_material))
    nodes = {}
    for name, (height, corners) in BLOCKS.items():
        centre = [sum(p[i] for p in corners) / 4 for i in range(2)]
        foot = [(x - centre[0], 0, z - centre[1]) for x, z in corners]
        top = [(x, height, z) for x, _, z in foot]
        quads = [top] + [[foot[i], foot[(i + 1) % 4], top[(i + 1) % 4], top[i]] for i in range(4)]
        inside = (0, height / 2000.0, 0)
        geometry = g.quads([facing(metres(q), inside, False) for q in quads])
        nodes[name] = (g.node(name, mesh=g.mesh(name, geometry, material["white"]),
                              translation=rounded(metres([(centre[0], 0, centre[1])])[0])), centre)
    eye = metres([CAMERA["position"]])[0]
    camera = g.add("cameras", {"name": "camera", "type": "perspective", "perspective": {
        "yfov": 2 * math.atan(CAMERA["film"] / 2 / CAMERA["focal"]), "aspectRatio": 1, "znear": 0.01}})
    # The original looks along +z, a glTF camera along -z: half a turn about y, which keeps +x on the left.
    camera_node = g.node("camera", camera=camera, translation=list(eye), rotation=[0, 1, 0, 0])
    if moving:
        times = [i / 24.0 for i in range(49)]
        node, centre = nodes["short block"]
        turn, slide, eyes, views = [], [], [], []
        distance = math.dist(eye, (0.278, 0.273, 0.28))
        for t in times:
            s = t / 2
            angle = math.radians(90 * s)
            turn.append((0, math.sin(angle / 2), 0, math.cos(angle / 2)))
            slide.append((centre[0] / 1000 + 0.1 * s, 0, centre[1] / 1000 - 0.045 * s))
            orbit = math.radians(6) * math.sin(math.pi * s)
            r = distance - 0.12 * s
            e = (0.278 + r * math.sin(orbit), 0.273 + 0.03 * s, 0.28 - r * math.cos(orbit))
            eyes.append(e)
            views.append(look_at(e, (0.278, 0.273, 0.28)))
        g.animate("move", [(node, "translation", times, slide), (node, "rotation", times, turn),
                           (camera_node, "translation", times, eyes), (camera_node, "rotation", times, views)])
    g.write(path)
    return colors, lamp


def noise(x, y, period, seed):
    """Value noise that repeats after `period` cells."""
    def value(i, j):
        h = ((i % period) * 374761393 + (j % period) * 668265263 + seed * 2147483647) & 0xffffffff
        h = ((h ^ (h >> 13)) * 1274126177) & 0xffffffff
        return ((h ^ (h >> 16)) & 0xffff) / 65535.0
    i, j = math.floor(x), math.floor(y)
    u, v = x - i, y - j
    u, v = u * u * (3 - 2 * u), v * v * (3 - 2 * v)
    return ((value(i, j) * (1 - u) + value(i + 1, j) * u) * (1 - v) +
            (value(i, j + 1) * (1 - u) + value(i + 1, j + 1) * u) * v)


def wood_rows(n):
    """Planks: two tones across, grain along v."""
    rows = []
    for y in range(n):
        row = []
        for x in range(n):
            plank = x * 4 // n
            grain = noise(x * 32 / n, y * 4 / n, 32, 3) * 0.6 + noise(x * 64 / n, y * 8 / n, 64, 5) * 0.4
            tone = 0.72 + 0.16 * ((plank * 37) % 4) / 3 + 0.18 * (grain - 0.5)
            if (x * 4) % n < 4:
                tone *= 0.45
            tone = round(tone * 32) / 32  # few tones: the file stays small
            row.append((tone * 0.80, tone * 0.58, tone * 0.38))
        rows.append(row)
    return rows


def tile_normals(n):
    """Tangent-space normals of the plank seams' bevels (green up, as glTF has it)."""
    rows = []
    for _ in range(n):
        row = []
        for x in range(n):
            s = (x * 4 / n) % 1
            slope = 0.5 if s > 0.94 else -0.5 if s < 0.06 else 0.0
            v = unit((slope, 0, 1))
            row.append(tuple(c * 0.5 + 0.5 for c in v))
        rows.append(row)
    return rows


def plate_rows(n):
    """Metallic (blue) and roughness (green): squares of polished metal in rough paint."""
    return [[(0, 0.15, 1) if (x * 4 // n + y * 4 // n) % 2 else (0, 0.75, 0) for x in range(n)] for y in range(n)]


def sphere(g, columns=40, rows=20):
    positions, uvs, triangles = [], [], []
    for j in range(rows + 1):
        theta = math.pi * j / rows
        for i in range(columns + 1):
            phi = 2 * math.pi * (i % columns) / columns
            positions.append((math.sin(theta) * math.cos(phi), math.cos(theta), -math.sin(theta) * math.sin(phi)))
            uvs.append((i / columns, j / rows))
    for j in range(rows):
        for i in range(columns):
            a, b = j * (columns + 1) + i, (j + 1) * (columns + 1) + i
            if j > 0:
                triangles += [a, b, a + 1]
            if j < rows - 1:
                triangles += [a + 1, b, b + 1]
    return g.geometry(positions, positions, uvs, triangles)


def gallery(path):
    g = Gltf([640, 360], {"environment": [{"type": "constant", "radiance": [0.05, 0.06, 0.08]}]})
    wood, seams, plate = (g.png("wood", 128, 128, wood_rows(128)), g.png("seams", 64, 64, tile_normals(64)),
                          g.png("plate", 64, 64, plate_rows(64)))

    def pbr(name, color, metallic, roughness, **more):
        return dict({"name": name, "pbrMetallicRoughness": {"baseColorFactor": list(color) + [1],
                                                            "metallicFactor": metallic,
                                                            "roughnessFactor": roughness}}, **more)
    gold = (1.0, 0.766, 0.336)
    floor = pbr("floor", (1, 1, 1), 0, 0.9, normalTexture={"index": seams, "scale": 1}, doubleSided=True)
    floor["pbrMetallicRoughness"]["baseColorTexture"] = {"index": wood}
    for use in (floor["normalTexture"], floor["pbrMetallicRoughness"]["baseColorTexture"]):
        g.extension(use, "KHR_texture_transform", {"scale": [2, 2]})
    plates = pbr("plates", (0.9, 0.6, 0.5), 1, 1)
    plates["pbrMetallicRoughness"]["metallicRoughnessTexture"] = {"index": plate}
    glass = pbr("glass", (1, 1, 1), 0, 0)
    g.extension(glass, "KHR_materials_transmission", {"transmissionFactor": 1})
    g.extension(glass, "KHR_materials_ior", {"ior": 1.5})
    g.extension(glass, "KHR_materials_volume", {"thicknessFactor": 0.8, "attenuationColor": [0.85, 0.95, 0.9],
                                                "attenuationDistance": 1.0})
    ball = sphere(g)
    balls = [("rough gold", pbr("rough gold", gold, 1, 0.6), (-1.5, 0.4, 0.1)),
             ("smooth gold", pbr("smooth gold", gold, 1, 0.1), (-0.55, 0.4, -0.35)),
             ("glossy plastic", pbr("glossy plastic", (0.7, 0.05, 0.04), 0, 0.15), (0.45, 0.4, -0.35)),
             ("glass", glass, (1.4, 0.4, 0.1))]
    for name, material, centre in balls:
        g.node(name, mesh=g.mesh(name, ball, g.add("materials", material)), translation=list(centre),
               scale=[0.4, 0.4, 0.4])

    def uv_of(p, n):  # one texture per metre on whichever side
        k = max(range(3), key=lambda i: abs(n[i]))
        u, v = [(p[2], p[1]), (p[0], p[2]), (p[0], p[1])][k]
        return (u, -v)
    s = 0.25
    corners = [[(sx * s, sy * s, sz * s) for sx in (-1, 1) for sy in (-1, 1) for sz in (-1, 1)]][0]
    sides = []
    for axis in range(3):
        for sign in (-1, 1):
            o = [i for i in range(3) if i != axis]
            ring = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
            quad = []
            for p, q in ring:
                v = [0, 0, 0]
                v[axis], v[o[0]], v[o[1]] = sign * s, p * s, q * s
                quad.append(tuple(v))
            sides.append(facing(quad, (0, 0, 0), False))
    assert all(p in corners for side in sides for p in side)
    block = g.quads(sides, lambda p, n: tuple(2 * c + 0.5 for c in uv_of(p, n)))
    half = math.radians(30) / 2
    g.node("plates", mesh=g.mesh("plates", block, g.add("materials", plates)), translation=[0, 0.25, 0.6],
           rotation=rounded([0, math.sin(half), 0, math.cos(half)]))
    ground = [(-4, 0, -2), (-4, 0, 4), (4, 0, 4), (4, 0, -2)]
    g.node("floor", mesh=g.mesh("floor", g.quads([ground], lambda p, n: (p[0] / 2, p[2] / 2)),
                                g.add("materials", floor)))
    wall = [(-4, 0, -2), (4, 0, -2), (4, 3, -2), (-4, 3, -2)]
    g.node("wall", mesh=g.mesh("wall", g.quads([wall]), g.add("materials", g.lambert("wall", (0.6, 0.62, 0.65)))))
    panel = [(-1.0, 2.4, -0.6), (1.0, 2.4, -0.6), (1.0, 2.4, 0.6), (-1.0, 2.4, 0.6)]
    g.node("panel", mesh=g.mesh("panel", g.quads([facing(panel, (0, 0, 0))]),
                                g.add("materials", g.emitter("panel", (0.8, 0.8, 0.8), (6, 5.7, 5.2)))))
    g.extension(g.doc, "KHR_lights_punctual", {"lights": [
        {"name": "lamp", "type": "point", "color": [1, 0.8, 0.6], "intensity": 2.5}]})
    lamp = g.node("lamp", translation=[-2.2, 1.8, 1.6])
    g.extension(g.doc["nodes"][lamp], "KHR_lights_punctual", {"light": 0})
    eye = (0.3, 1.25, 4.2)
    camera = g.add("cameras", {"name": "camera", "type": "perspective",
                               "perspective": {"yfov": math.radians(35), "aspectRatio": 16 / 9, "znear": 0.01}})
    g.node("camera", camera=camera, translation=list(eye), rotation=rounded(look_at(eye, (0, 0.45, 0))))
    g.write(path)


def main():
    out = sys.argv[1] if len(sys.argv) > 1 else os.path.dirname(os.path.abspath(__file__))
    colors, lamp = cornell(os.path.join(out, "cornell-box.gltf"), False)
    cornell(os.path.join(out, "cornell-box-moving.gltf"), True)
    gallery(os.path.join(out, "material-gallery.gltf"))
    for name, c in list(colors.items()) + [("lamp", lamp)]:
        print("%-6s %.4f %.4f %.4f" % ((name,) + tuple(c)))


if __name__ == "__main__":
    main()
