// What the checks of recordings and of live flights share: problems, and messages read by their schemas.

import protobuf from "protobufjs";
import descriptor from "protobufjs/ext/descriptor.js";

const problems = [];

export function expect(condition, text) {
  if (!condition && problems.length < 50) {
    problems.push(text);
  }
}

/** Names the problems, and ends with 1 if there are any. */
export function end() {
  for (const problem of problems) {
    console.error(`PROBLEM ${problem}`);
  }
  process.exit(problems.length > 0 ? 1 : 0);
}

/** The type that a schema declares, from its descriptors. */
export function typeOf(name, data) {
  const root = protobuf.Root.fromDescriptor(descriptor.FileDescriptorSet.decode(data));
  root.resolveAll();
  return root.lookupType(name);
}

/** Reads every field by its name; counts the values, and refuses numbers that an enum does not name. */
export function walk(message, type, where) {
  let values = 0;
  for (const field of type.fieldsArray) {
    const value = message[field.name];
    for (const item of field.repeated ? value : [value]) {
      if (item == null) {
        continue;
      }
      if (field.resolvedType instanceof protobuf.Type) {
        values += walk(item, field.resolvedType, `${where}.${field.name}`);
        continue;
      }
      values += 1;
      if (field.resolvedType instanceof protobuf.Enum) {
        const known = item in field.resolvedType.valuesById;
        expect(known, `${where}.${field.name}: ${item} is no ${field.resolvedType.name}`);
      }
    }
  }
  return values;
}
