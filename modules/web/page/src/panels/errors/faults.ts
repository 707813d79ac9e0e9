// Meaning of a fault's number.
import { FAULTS } from "../../numbers";
import { t } from "../../words";
import { hex } from "../format";
import { words } from "../../words/language";

export interface Fault {
  name: string;
  means: string;
  /** What to do about it; empty: the page does not know. */
  remedy: string;
}

/** From here on numbers are those of foreign modules, each module's own (docs/writing-a-module.md). */
const FOREIGN = 0x8000;

/** Where the documentation has it, which the robot does not serve: the file, and what to search for in it. */
export function place(number: number): { file: string; entry: string } {
  if (number >= FOREIGN) return { file: "docs/writing-a-module.md", entry: hex(FOREIGN) };
  const known = FAULTS.get(number);
  return { file: "docs/faults.md", entry: known ? `${hex(number)} ${known.name}` : hex(number) };
}

/** What a number stands for. */
export function fault(number: number): Fault {
  const known = FAULTS.get(number);
  if (known) return { name: known.name, means: words.value?.faults[number] ?? known.means, remedy: words.value?.remedies[number] ?? known.remedy };
  if (number === FOREIGN) return { name: "Uncaught", means: t("A foreign module was ended by an error that nothing in it caught."), remedy: "" };
  if (number > FOREIGN) return { name: "Foreign", means: t("A number of the module's own: read it with the module's name."), remedy: "" };
  return { name: "Unknown", means: t("This page does not know the number: the robot's software is newer or older than it."), remedy: "" };
}
