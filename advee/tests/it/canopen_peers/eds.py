"""Objects that `canopen` (PyPI) reads from an EDS or DCF: `eds.py NODE FILE...`; one line of JSON per file, `null` for
an unreadable one. Objects by index and sub-index: data type, access, mappable, default, parameter value."""
import json
import sys

import canopen
from canopen.objectdictionary import ODVariable


def number(value):
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def read(file, node):
    try:
        objects = canopen.import_od(file, node)
    except Exception as error:  # Any error: the file is not comparable.
        print(f"{file}: {error!r}", file=sys.stderr)
        return None
    found = []
    for group in objects.values():
        for variable in [group] if isinstance(group, ODVariable) else group.values():
            found.append([
                variable.index, variable.subindex, variable.data_type, variable.access_type,
                bool(variable.pdo_mappable), number(variable.default), number(variable.value),
            ])
    return sorted(found)


for name in sys.argv[2:]:
    print(json.dumps(read(name, int(sys.argv[1]))))
