// What every view is made of.
export { Aged, Age } from "./aged";
export { Badge, type Tone } from "./badge";
export { Button } from "./button";
export { Card } from "./card";
export { Dialog } from "./dialog";
export { Slide } from "./slide";
export { Table, type Column } from "./table";
export { toast } from "./news";
export { Toasts } from "./toast";
export { Facts, type Fact } from "./facts";
export { Empty } from "./empty";
