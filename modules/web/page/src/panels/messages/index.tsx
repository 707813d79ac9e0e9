// What is said on the bus: channels with their rates; of one its fields, live; of any field its course.
import { useEffect } from "preact/hooks";
import { Channels } from "./channels";
import { Inspected } from "./inspected";
import { Plots } from "./plots";
import { chosen, look } from "./store";
import "../panels.css";

export function Messages() {
  useEffect(look, []);
  return (
    <div class={chosen.value === null ? "p-inspector" : "p-inspector has-chosen"}>
      <Channels />
      <div class="p-detail">
        <Inspected />
        <Plots />
      </div>
    </div>
  );
}
