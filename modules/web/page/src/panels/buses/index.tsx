// The buses with the nodes on them, the drives, and what stands in a drive's dictionary.
import { Axes } from "./axes";
import { BusList } from "./list";
import { SdoBrowser } from "./browser";
import "../panels.css";

export function Buses() {
  return (
    <div class="stack">
      <Axes />
      <BusList />
      <SdoBrowser />
    </div>
  );
}
