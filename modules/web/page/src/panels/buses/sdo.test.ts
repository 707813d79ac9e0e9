import { deepEqual, equal, ok } from "node:assert/strict";
import { test } from "node:test";
import { DATA_MAX, encode, fromHex, index, interpret, interpretations, OBJECTS, toHex, TYPES, wholeNumber } from "./sdo";

const data = (text: string): Uint8Array => fromHex(text) ?? new Uint8Array();
const written = (text: string, type: (typeof TYPES)[number]): string => {
  const encoded = encode(text, type);
  return "data" in encoded ? toHex(encoded.data) : encoded.why;
};

test("bytes are read least significant first", () => {
  equal(interpret(data("92010200"), "u32"), "131474");
  equal(interpret(data("ffff"), "i16"), "-1");
  equal(interpret(data("ffff"), "u16"), "65535");
  equal(interpret(data("80"), "i8"), "-128");
  equal(interpret(data("ffffffffffffffff"), "u64"), "18446744073709551615");
  equal(interpret(data("0000c03f"), "f32"), "1.5");
  equal(interpret(data("45504f5300"), "text"), "EPOS");
  equal(interpret(data("4e0a36"), "text"), "N·6");
  equal(interpret(data("0a1b"), "hex"), "0A 1B");
});

test("a length that is not the type's is no value of it", () => {
  equal(interpret(data("01"), "u32"), null);
  equal(interpret(new Uint8Array(), "u8"), null);
  deepEqual(
    interpretations(data("4142")).map(({ type }) => type),
    ["u16", "i16", "text", "hex"],
  );
  const types = (text: string) => interpretations(data(text)).map(({ type }) => type);
  deepEqual(types("0000c03f"), ["u32", "i32", "f32", "hex"]);
  deepEqual(types("92010200"), ["u32", "i32", "hex"]);
});

test("what is written is what is read again", () => {
  for (const [text, type] of [["200", "u8"], ["-128", "i8"], ["65535", "u16"], ["-1", "i32"], ["4294967295", "u32"], ["-9223372036854775808", "i64"], ["1.5", "f32"], ["EPOS", "text"]] as const) {
    const encoded = encode(text, type);
    ok("data" in encoded, `${text} as ${type}`);
    if ("data" in encoded) equal(interpret(encoded.data, type), text);
  }
  equal(written("0x1F4", "u16"), "f401");
  equal(written("0A 1b", "hex"), "0a1b");
});

test("what no type holds is refused in words", () => {
  equal(written("256", "u8"), "u8 holds 0 to 255.");
  equal(written("-1", "u8"), "u8 holds 0 to 255.");
  equal(written("128", "i8"), "i8 holds -128 to 127.");
  for (const text of ["", "1.5", "abc", "0x", "1e3", "--1"]) ok(written(text, "u32").startsWith("A whole number"), text);
  for (const text of ["", "NaN", "1e39", "x"]) equal(written(text, "f32"), "A number is expected.");
  for (const text of ["", "0", "zz"]) ok(written(text, "hex").startsWith("Pairs"), text);
  equal(written("", "text"), "Some text is expected.");
  equal(written("a".repeat(DATA_MAX + 1), "text"), `At most ${DATA_MAX} bytes.`);
});

test("hexadecimal takes blanks and 0x, and nothing else", () => {
  deepEqual(fromHex("0x0A 1b:2c"), Uint8Array.of(10, 27, 44));
  for (const text of ["0", "0g", "12 3"]) equal(fromHex(text), null, text);
});

test("numbers of objects are bounded", () => {
  deepEqual(["6041", "0x6041", " 1000 ", "10000", "x", ""].map(index), [0x6041, 0x6041, 0x1000, null, null, null]);
  deepEqual(["0", "127", "0x7F", "128", "-1", "1.5", ""].map((text) => wholeNumber(text, 0, 127)), [0, 127, 127, null, null, null, null]);
});

test("the objects are listed once each, in order", () => {
  const keys = OBJECTS.map((object) => object.index * 256 + object.subindex);
  deepEqual(keys, [...new Set(keys)].sort((a, b) => a - b));
});
