// The busses with the nodes on them, the drives, and what stands in a drive's dictionary.
import { Axes } from "./axes";
import { BusList } from "./list";
import { SdoBrowser } from "./browser";
import "../panels.css";

export function Busses() {
  return (
    <div class="stack">
      <Axes />
      <BusList />
      <SdoBrowser />
    </div>
  );
}
