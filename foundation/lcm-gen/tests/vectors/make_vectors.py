#!/usr/bin/env python3
"""Produce vectors.json from the official LCM tools (see README.md).

usage: make_vectors.py LCM_PREFIX WORKDIR
  LCM_PREFIX  unpacked wheel of the Python package `lcm` (has bin/, lib/, include/, lcm/)
  WORKDIR     scratch folder
"""
import glob, json, os, re, struct, subprocess, sys

prefix, work = sys.argv[1], sys.argv[2]
here = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, prefix)
env = dict(os.environ, LD_LIBRARY_PATH=prefix + "/lib")
gen = prefix + "/bin/lcm-gen"
types = sorted(glob.glob(here + "/types/*.lcm"))
for d in ("py", "c", "cpp"):
    os.makedirs(f"{work}/{d}", exist_ok=True)
run = lambda *a: subprocess.run(a, env=env, check=True, capture_output=True, text=True).stdout
# lcm-gen keeps the last `package` directive from one input file to the next, so the file without a
# package has to be given to a run of its own.
dump = ""
for group in ([t for t in types if "nopkg" not in t], [t for t in types if "nopkg" in t]):
    run(gen, "-p", "--ppath", work + "/py", *group)
    run(gen, "-c", "--c-cpath", work + "/c", "--c-hpath", work + "/c", *group)
    run(gen, "-x", "--cpp-hpath", work + "/cpp", *[t for t in group if "enum" not in t])
    dump += run(gen, "-d", *group)
base = {m[0]: int(m[1].replace(" ", "0"), 16)
        for m in re.findall(r"struct (\S+) \[hash=0x(.{16})\]", dump)}
sys.path.insert(0, work + "/py")
import lcm  # noqa: E402

PRIM = {"int8_t", "int16_t", "int32_t", "int64_t", "byte", "float", "double", "string", "boolean"}
file_of = {}
for t in types:
    pkg = ""
    src = re.sub(r"//[^\n]*|/\*.*?\*/", "", open(t).read(), flags=re.S)
    for kw, name in re.findall(r"\b(package|struct|enum)\s+([\w.]+)", src):
        if kw == "package":
            pkg = name
        else:
            file_of[(pkg + "." if pkg else "") + name] = "types/" + os.path.basename(t)


def cls(name):
    if "." not in name:
        return getattr(__import__(name), name)
    pkg, short = name.rsplit(".", 1)
    return getattr(__import__(pkg, fromlist=[short]), short)


def build(name, val):
    """Fill an official python message class from plain JSON-like data."""
    o = cls(name)()
    for slot, tn, dims in zip(o.__slots__, o.__typenames__, o.__dimensions__):
        setattr(o, slot, conv(tn, dims or [], val[slot]))
    return o


def conv(tn, dims, v):
    if dims:
        if tn == "byte" and len(dims) == 1:
            return bytes.fromhex(v)
        return [conv(tn, dims[1:], x) for x in v]
    if tn in ("float", "double"):
        return float(v)
    return v if tn in PRIM else build(tn, v)


P = lambda x, y, z: dict(x=x, y=y, z=z)
prim = dict(i8=-128, i16=-32768, i32=-2147483648, i64=-9223372036854775808, f32=-1.5, f64=0.1,
            str="Advee", flag=True, raw=255, a_i8=[-1, 0, 127], a_i16=[-2, 0, 32767],
            a_i32=[-3, 0, 2147483647], a_i64=[-4, 0, 9223372036854775807],
            a_f32=[0.5, -0.25, 16777216.0], a_f64=[1e-300, -1e300, 3.141592653589793],
            a_str=["", "a", "\u017elu\u0165ou\u010dk\u00fd k\u016f\u0148"], a_flag=[True, False, True],
            a_raw="00ff7f")
prim2 = dict(prim, i8=1, i16=2, i32=3, i64=4, f32="inf", f64="-inf", str="", flag=False, raw=0,
             a_f32=["-0.0", 1.401298464324817e-45, 3.4028234663852886e38],
             a_f64=[5e-324, 1.7976931348623157e308, "-0.0"])
leaf = lambda n, ch=(): dict(name=n, num_children=len(ch), children=list(ch))
ping = dict(id=7, npongs=2, pongs=[dict(stamp=1, npings=0, pings=[]),
            dict(stamp=-2, npings=1, pings=[dict(id=8, npongs=0, pongs=[])])])
messages = [
    ("vec.primitives_t", "extremes", prim),
    ("vec.primitives_t", "infinities, denormals, negative zero, empty string", prim2),
    ("vec.constants_t", "dimensions from constants", dict(grid=[[1, 2, 3], [4, 5, 6]], plain=[-1, 1])),
    ("vec.constants_dec_t", "same body as the previous, other fingerprint",
     dict(grid=[[1, 2, 3], [4, 5, 6]], plain=[-1, 1])),
    ("vec.geom.point_t", "", P(1, -2.5, 1e10)),
    ("vec.nested_t", "three path points", dict(utime=1321867200000000, origin=P(0, 0, 0),
     corners=[P(1, 1, 1), P(-1, -1, -1)], npath=3, path=[P(i, i * .5, -i) for i in range(3)], prim=prim)),
    ("vec.nested_t", "empty variable array", dict(utime=-1, origin=P(9, 8, 7),
     corners=[P(0, 0, 1), P(0, 1, 0)], npath=0, path=[], prim=prim2)),
    ("vec.arrays_t", "n=2 m=3", dict(n=2, m=3, fixed1=[1, 2, 3], fixed2=[[1, 2, 3], [4, 5, 6]],
     var1=[-1, 1], var2=[[1, 2, 3], [4, 5, 6]], mixed_vf=[[1, 2], [3, 4]], mixed_fv=[[1, 2, 3], [4, 5, 6]],
     cube=[[[0, 1, 2], [3, 4, 5]], [[6, 7, 8], [9, 10, 11]]], blob="010203", blobs=["00010203", "fcfdfeff"],
     flags=[True, False], names=["x", "", "zz"], table=[["a", "b"], ["c", "d"]])),
    ("vec.arrays_t", "n=0 m=0", dict(n=0, m=0, fixed1=[0, 0, 0], fixed2=[[0, 0, 0], [0, 0, 0]], var1=[],
     var2=[], mixed_vf=[], mixed_fv=[[], []], cube=[], blob="", blobs=[], flags=[], names=[], table=[])),
    ("vec.tree_t", "three levels", leaf("root", [leaf("l", [leaf("ll")]), leaf("r")])),
    ("vec.tree_t", "leaf", leaf("")),
    ("vec.ping_t", "mutual recursion", ping),
    ("vec.pong_t", "mutual recursion from the other side", ping["pongs"][1]),
    ("vec.deep.er.wrapper_t", "", dict(left=leaf("L"), right=leaf("R", [leaf("x")]))),
    ("vec.empty_t", "fingerprint only", {}),
    ("nopkg_t", "no package", dict(s="bez bal\u00ed\u010dku", _private=-42, v=6.02e23)),
    ("vec.several_b_t", "", dict(a=dict(a=1), list=[dict(a=2), dict(a=3)])),
    ("vec.other.several_c_t", "", dict(b=dict(a=dict(a=1), list=[dict(a=2), dict(a=3)]), d=dict(v=200))),
    ("advee.range_scan_t", "codec benchmark message", dict(utime=1321867200123456, sensor="HOKUYO_FRONT",
     ranges=[dict(distance=0.25 * i, bearing=-1.5 + 0.2 * i, status=i - 8) for i in range(16)])),
]

out_types, out_msgs = [], []
for name in sorted(set(base) | {"vec.color_t"}):
    fp = struct.unpack(">Q", cls(name)._get_packed_fingerprint())[0]
    out_types.append(dict(type=name, file=file_of[name], kind="enum" if name == "vec.color_t" else "struct",
                          base_hash="%016x" % base[name] if name in base else None, fingerprint="%016x" % fp))
for name, note, val in messages:
    hx = build(name, val).encode().hex()
    out_msgs.append(dict(type=name, note=note, value=val, size=len(hx) // 2, hex=hx))

# ---- C cross-check: every hash, and decode + encode of every message, with the generated C code
cn = lambda n: n.replace(".", "_")
# (mutually recursive types do not compile in C or C++: their headers include each other)
structs = [t["type"] for t in out_types if t["kind"] == "struct" and t["type"] not in ("vec.ping_t", "vec.pong_t")]
with open(work + "/check.c", "w") as f:
    for n in structs:
        f.write(f'#include "{cn(n)}.h"\n')
    f.write('#include <stdio.h>\n#include <string.h>\nint main(int c,char**v){static unsigned char b[1<<16],o[1<<16];\n')
    for n in structs:
        f.write(f'if(c==1)printf("H {n} %016llx\\n",(unsigned long long)__{cn(n)}_get_hash());\n'
                f'else if(!strcmp(v[1],"{n}")){{int l=strlen(v[2])/2;for(int i=0;i<l;i++)sscanf(v[2]+2*i,"%2hhx",b+i);'
                f'{cn(n)} m;if({cn(n)}_decode(b,0,l,&m)!=l)return 2;int k={cn(n)}_encode(o,0,sizeof o,&m);'
                f'if(k!=l||{cn(n)}_encoded_size(&m)!=l)return 4;{cn(n)}_decode_cleanup(&m);return memcmp(b,o,l)?3:0;}}\n')
    f.write('if(c==1){vec_enum_user_t e={-5,VEC_COLOR_T_NEXT,5};int k=vec_enum_user_t_encode(o,0,sizeof o,&e);'
            'printf("E vec.enum_user_t ");for(int i=0;i<k;i++)printf("%02x",o[i]);puts("");}\nreturn 0;}\n')
run("gcc", "-w", "-I" + prefix + "/include", "-I" + work + "/c", "-o", work + "/check", work + "/check.c",
    *[g for g in glob.glob(work + "/c/*.c") if "ping" not in g and "pong" not in g],
    "-L" + prefix + "/lib", "-llcm", "-l:libglib-2.0.so.0")
res = run(work + "/check").split("\n")
ch = {l.split()[1]: l.split()[2] for l in res if l.startswith("H ")}
for t in out_types:
    if t["type"] in structs:
        assert ch[t["type"]] == t["fingerprint"], (t, ch[t["type"]])
for m in out_msgs:
    m["checked_with_c"] = m["type"] in structs
    if m["checked_with_c"]:
        run(work + "/check", m["type"], m["hex"])
enum_hex = [l.split()[2] for l in res if l.startswith("E ")][0]
out_msgs.append(dict(type="vec.enum_user_t", note="scalar enum member = int32; from the C code (the python class of a "
                     "struct with an enum member cannot be constructed)",
                     checked_with_c=True, value=dict(before=-5, color=8, after=5), size=len(enum_hex) // 2, hex=enum_hex))
print("C cross-check: %d hashes, %d messages agree" % (len(ch), sum(m["checked_with_c"] for m in out_msgs)))

with open(here + "/vectors.json", "w") as f:
    json.dump(dict(made_with=dict(lcm=run(gen, "--version").strip().split()[-1], python=sys.version.split()[0]),
                   types=out_types, messages=out_msgs), f, indent=1, ensure_ascii=True)
    f.write("\n")
print(len(out_types), "types", len(out_msgs), "messages")
